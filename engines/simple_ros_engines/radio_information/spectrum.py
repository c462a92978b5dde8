"""What a link's spectrum looks like: utilisation, interference, zones. Pure.

Utilisation is blocks in use by blocks of the carrier. Interference is over noise: RSSI minus RSRP is
none, since it holds the width of the carrier and mixes directions. From RSRQ = N RSRP/RSSI (TS 38.215,
5.1.3) and the load of the cell follows what of RSSI is neither this cell's signal nor thermal noise.
"""

from __future__ import annotations

import math

from simple_ros_engines.radio.carrier import RE_PER_PRB
from simple_ros_engines.radio_information.history import Session
from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["ZONES", "interference_over_noise_db", "own_share", "utilization", "zones"]

THERMAL_DBM_PER_HZ = -173.8
_SYMBOL_RES = 12


def utilization(session: Session, slots_per_s: float, n_prb: int) -> float | None:
    """Share of the carrier's blocks in use, 0..1; None if no source tells.

    From blocks in use of the cell, else of this link, else from what the counters rose by.

    Args:
        session: The link.
        slots_per_s: Of the direction the counters are of.
        n_prb: Blocks of the carrier, if the record does not tell.
    """
    newest = session.newest
    used = newest.get("prb_cell_used")
    if used is None:
        return own_share(session, slots_per_s, n_prb)
    return min(1.0, max(0.0, used / (newest.get("prb_total") or n_prb)))


def own_share(session: Session, slots_per_s: float, n_prb: int) -> float | None:
    """Share of the carrier's blocks that this link uses, 0..1; None if no source tells.

    Args:
        session: The link.
        slots_per_s: Of the direction the counters are of.
        n_prb: Blocks of the carrier, if the record does not tell.
    """
    used = session.newest.get("prb_used")
    if used is None:
        risen = session.delta("dl_rbs_total") or session.delta("ul_rbs_total")
        if risen is None:
            return None
        used = risen[0] / (risen[1] * slots_per_s)
    return min(1.0, max(0.0, used / (session.newest.get("prb_total") or n_prb)))


def interference_over_noise_db(
    record: LinkRecord, scs_khz: int = 30, noise_figure_db: float = 7.0
) -> float | None:
    """(I+N)/N of the downlink, dB; None if the record has not what it takes.

    From RSRP and SINR where there are both, else from RSRP and RSRQ with the load of the cell.
    """
    rsrp = record.get("rsrp_dbm")
    if rsrp is None:
        return None
    noise_mw = 10 ** ((THERMAL_DBM_PER_HZ + noise_figure_db) / 10) * scs_khz * 1e3
    sinr = record.get("dl_sinr_db")
    if sinr is not None:
        return max(0.0, rsrp - sinr - 10 * math.log10(noise_mw))
    rsrq = record.get("rsrq_db")
    if rsrq is None:
        return None
    signal_mw = 10 ** (rsrp / 10)
    # All of one block, per subcarrier: RSRQ = RSRP / (RSSI / N).
    per_subcarrier_mw = signal_mw / 10 ** (rsrq / 10) / _SYMBOL_RES
    used, total = record.get("prb_cell_used"), record.get("prb_total")
    load = used / total if used is not None and total else 0.5
    # Without data two of twelve subcarriers carry reference signals.
    own_mw = signal_mw * (1 / 6 + 5 / 6 * load)
    rest_mw = max(noise_mw, per_subcarrier_mw - own_mw)
    return 10 * math.log10(rest_mw / noise_mw)


ZONES = ("HIGH_INTERFERENCE_ZONE", "SIGNAL_DEGRADATION_ZONE", "POOR_CHANNEL_ZONE")
"""Names of the rules of `zones`."""


def zones(record: LinkRecord) -> tuple[str, ...]:
    """All the rules that hold: weak reference but much power, bad ratio in spite of power, errors at a low scheme."""
    rsrp, rssi = record.get("rsrp_dbm"), record.get("rssi_dbm")
    side = record.side()
    found = []
    if rsrp is not None and rssi is not None and rsrp < -100 and rssi > -80:
        found.append(ZONES[0])
    if side.snr_db is not None and rssi is not None and side.snr_db < 10 and rssi > -70:
        found.append(ZONES[1])
    if side.bler is not None and side.mcs is not None and side.bler > 0.1 and side.mcs < 10:
        found.append(ZONES[2])
    return tuple(found)


def resource_elements(prb: float) -> int:
    """Resource elements of an allocation, at least one block."""
    return int(max(1.0, prb) * RE_PER_PRB)
