"""What a gNB's slice policy file says about shares of resource blocks. Pure."""

from __future__ import annotations

from typing import Any

from simple_ros.errors import ConfigError

__all__ = ["policy_shares"]


def policy_shares(data: Any) -> dict[int, dict[str, tuple[float, float]]]:
    """Least and largest share of the blocks by RNTI and direction, from a gNB's slice policy file.

    Devices in one sub-slice share its least ratio evenly.

    Raises:
        ConfigError: It is no such policy.
    """
    keys = {"down": "target_sub_slice", "up": "up_target_sub_slice"}
    shares: dict[int, dict[str, tuple[float, float]]] = {}
    try:
        slices = {
            item["sub_slice_id"]: (item["min_ratio"] / 100, item["max_ratio"] / 100)
            for item in data["subSlicePolicy"]["subSlices"]
        }
        devices = {int(rnti, 16): target for rnti, target in data["ueSliceMapping"].items()}
        for way, key in keys.items():
            members = [target.get(key) for target in devices.values()]
            for rnti, target in devices.items():
                low, high = slices.get(target.get(key), (0.0, 1.0))
                least = min(low / members.count(target.get(key)), high)
                shares.setdefault(rnti, {})[way] = (least, high)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"no slice policy of a gNB: {error!r}") from None
    return shares
