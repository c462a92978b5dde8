"""Durability: a latched map reaches a node that joins long after it was published."""

import numpy as np

from simple_ros import LATCHED, aio
from simple_ros.msg.arrays import numpy_to_occupancy_grid, occupancy_grid_to_numpy
from simple_ros.msg.nav_msgs import OccupancyGrid


async def main() -> None:
    async with aio.NodeHandle("map_server") as server, aio.NodeHandle("late_planner") as planner:
        publisher = await server.advertise("map", OccupancyGrid, qos=LATCHED)
        cells = np.zeros((3, 4), dtype=np.int8)
        cells[1, 2] = 100
        publisher.publish(numpy_to_occupancy_grid(cells, resolution_m=0.05))

        maps = await planner.subscribe("map", OccupancyGrid, qos=LATCHED)
        grid = occupancy_grid_to_numpy(await maps.receive())
        print(f"occupied cells: {np.argwhere(grid == 100).tolist()}")


aio.run(main())
