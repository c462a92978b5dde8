"""numpy views of array fields, and messages built from arrays.

Where the bytes of a message can serve as they are, the result is a read-only view on them and costs
no copy beyond the one protobuf makes when a bytes field is read. Write to ``result.copy()``, not to
the view. Every function raises ValueError for a message or an array that makes no sense, and says
what is wrong with it.

======================  =====================================  =====================================
message                 to numpy                               from numpy
======================  =====================================  =====================================
Image                   `image_to_numpy`                       `numpy_to_image`
PointCloud2             `pointcloud2_to_numpy`,                `numpy_to_pointcloud2`,
                        `pointcloud2_to_points`                `points_to_pointcloud2`
LaserScan               `laser_scan_ranges`,                   `numpy_to_repeated`
                        `laser_scan_intensities`,
                        `laser_scan_angles`,
                        `laser_scan_points`
OccupancyGrid           `occupancy_grid_to_numpy`              `numpy_to_occupancy_grid`
...MultiArray           `multiarray_to_numpy`                  `numpy_to_multiarray`
covariance fields       `covariance_3x3`, `covariance_6x6`     `numpy_to_covariance`
any repeated number     `repeated_to_numpy`                    `numpy_to_repeated`
======================  =====================================  =====================================
"""

from simple_ros.msg.arrays.covariances import covariance_3x3, covariance_6x6, numpy_to_covariance
from simple_ros.msg.arrays.grids import numpy_to_occupancy_grid, occupancy_grid_to_numpy
from simple_ros.msg.arrays.images import image_to_numpy, image_type, numpy_to_image
from simple_ros.msg.arrays.multi_arrays import (
    MultiArray,
    multiarray_to_numpy,
    numpy_to_multiarray,
)
from simple_ros.msg.arrays.point_clouds import (
    numpy_to_pointcloud2,
    pointcloud2_dtype,
    pointcloud2_to_numpy,
    pointcloud2_to_points,
    points_to_pointcloud2,
)
from simple_ros.msg.arrays.repeated import numpy_to_repeated, repeated_to_numpy
from simple_ros.msg.arrays.scans import (
    laser_scan_angles,
    laser_scan_intensities,
    laser_scan_points,
    laser_scan_ranges,
)

__all__ = [
    "MultiArray",
    "covariance_3x3",
    "covariance_6x6",
    "image_to_numpy",
    "image_type",
    "laser_scan_angles",
    "laser_scan_intensities",
    "laser_scan_points",
    "laser_scan_ranges",
    "multiarray_to_numpy",
    "numpy_to_covariance",
    "numpy_to_image",
    "numpy_to_multiarray",
    "numpy_to_occupancy_grid",
    "numpy_to_pointcloud2",
    "numpy_to_repeated",
    "occupancy_grid_to_numpy",
    "pointcloud2_dtype",
    "pointcloud2_to_numpy",
    "pointcloud2_to_points",
    "points_to_pointcloud2",
    "repeated_to_numpy",
]
