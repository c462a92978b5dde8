"""From values to messages: pure."""

from __future__ import annotations

from collections.abc import Iterable

from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    FieldQuality,
    PhyLayerMetrics,
    SpectrumAnalysis,
)
from simple_ros.msg.wireless_ros_msgs import Forecast as ForecastMessage
from simple_ros_engines.radio_information.core import Findings
from simple_ros_engines.radio_information.prediction import Forecast
from simple_ros_engines.radio_information.record import LinkRecord, Quality

__all__ = ["channel_state", "forecast_message", "phy_metrics", "spectrum_analysis", "zone_text"]

_FLOATS: dict[str, tuple[str, float]] = {
    "dl_thr_bps": ("dl_thr", 1e-6),
    "ul_thr_bps": ("ul_thr", 1e-6),
    "power_headroom_db": ("ph", 1.0),
    "pcmax_dbm": ("pcmax", 1.0),
    "rsrp_dbm": ("avg_rsrp", 1.0),
    "rssi_dbm": ("raw_rssi", 1.0),
    "ul_rssi_dbm": ("ul_rssi", 1.0),
    "ul_snr_db": ("pusch_snr", 1.0),
    "dl_bler": ("dl_bler", 1.0),
    "ul_bler": ("ul_bler", 1.0),
    "dl_sinr_db": ("dl_sinr", 1.0),
    "rsrq_db": ("rsrq", 1.0),
    "rtt_ms": ("rtt_ms", 1.0),
    "loss": ("loss", 1.0),
    "prb_used": ("prb_used", 1.0),
    "prb_cell_used": ("prb_cell_used", 1.0),
    "echo_rtt_ms": ("echo_rtt_ms", 1.0),
}
_INTS = {
    "frame": "frame",
    "slot": "slot",
    "cqi": "cqi",
    "ri": "ri",
    "dl_mcs": "dl_mcs",
    "ul_mcs": "ul_mcs",
    "buffer_bytes": "estimated_ul_buffer",
    "dl_bytes_total": "dlsch_total_bytes",
    "ul_bytes_total": "ulsch_total_bytes",
    "dl_rbs_total": "dl_total_rbs",
    "ul_rbs_total": "ul_total_rbs",
    "prb_total": "prb_total",
    "rsrp_samples": "num_rsrp_meas",
    "dl_max_mcs": "dl_max_mcs",
    "ul_bytes_scheduled": "sched_ul_bytes",
    "sdu_bytes_total": "num_total_bytes",
    "dl_pdus_total": "dl_pdus_total",
    "dl_blocks_lost": "dlsch_errors",
    "ul_blocks_lost": "ulsch_errors",
    "dl_bytes_slot": "dlsch_current_bytes",
    "ul_bytes_slot": "ulsch_current_bytes",
    "dl_rbs_slot": "dl_current_rbs",
    "ul_rbs_slot": "ul_current_rbs",
    "dl_sdus_total": "dl_num_mac_sdu",
    "ul_sdus_total": "ul_num_mac_sdu",
}
_OURS = {ours: theirs for ours, (theirs, _) in _FLOATS.items()} | _INTS | {"in_sync": "in_sync"}
_QUALITIES = {quality: FieldQuality.Name(quality) for quality in FieldQuality.values()}


def channel_state(
    record: LinkRecord, session: int, *, missing: Iterable[str] = (), age_s: float = 0.0
) -> ChannelState:
    """The message of a record; fields by the names of WirelessROS.

    Args:
        record: The record.
        session: Number of its session.
        missing: Fields that the link's record before had and this one has not; flagged.
        age_s: How old the record was when it came.
    """
    message = ChannelState(
        rnti=record.rnti or 0,
        link_id=record.link_id,
        session=session,
        source=record.source,
        age_s=age_s,
    )
    message.header.stamp.FromNanoseconds(record.stamp_ns)
    for name, value in record.values.items():
        if name in _FLOATS:
            theirs, factor = _FLOATS[name]
            setattr(message, theirs, value * factor)
        elif name in _INTS:
            setattr(message, _INTS[name], int(value))
    message.in_sync = bool(record.get("in_sync"))
    flags = {_OURS[name]: int(flag) for name, flag in record.quality.items() if name in _OURS}
    flags |= {_OURS[name]: int(Quality.MISSING) for name in missing if name in _OURS}
    for name, flag in flags.items():
        message.field_quality[name] = FieldQuality.ValueType(flag)
    return message


def phy_metrics(findings: Findings) -> PhyLayerMetrics:
    """How good the link is."""
    record, quality = findings.record, findings.quality
    side = record.side()
    message = PhyLayerMetrics(
        rnti=record.rnti or 0,
        link_id=record.link_id,
        link_quality=quality.quality,
        channel_stability=quality.stability,
        reliability=quality.reliability,
        spectral_efficiency=quality.efficiency,
        channel_capacity=quality.capacity,
        channel_response_time=quality.response_ms or 0.0,
        throughput_bps=record.throughput_bps() or 0.0,
        available_bps=findings.available_bps or 0.0,
        buffer_bytes=record.get("buffer_bytes") or 0.0,
        snr_db=side.snr_db or 0.0,
        bler=side.bler or 0.0,
        mcs=side.mcs or 0,
        prb_total=int(record.get("prb_total") or 0),
    )
    message.header.stamp.FromNanoseconds(record.stamp_ns)
    return message


def spectrum_analysis(findings: Findings, place: PoseStamped | None = None) -> SpectrumAnalysis:
    """What the spectrum looks like, and where, if the link is that of a robot whose place is known."""
    record = findings.record
    message = SpectrumAnalysis(
        rnti=record.rnti or 0,
        link_id=record.link_id,
        utilization=findings.utilization or 0.0,
        utilization_known=findings.utilization is not None,
        interference_level=findings.interference_db or 0.0,
        interference_known=findings.interference_db is not None,
        estimated_snr=record.side().snr_db or 0.0,
        spectral_efficiency=findings.quality.efficiency,
        anomaly_detected=bool(findings.present),
        anomaly_type=",".join(findings.present),
        zones=findings.zones,
        interference_pattern=findings.interferes,
    )
    message.header.stamp.FromNanoseconds(record.stamp_ns)
    if place is not None:
        message.position_known = True
        message.position.CopyFrom(place.pose.position)
        message.frame_id = place.header.frame_id
    return message


def zone_text(link_id: str, zone: str, place: PoseStamped | None = None) -> str:
    """A zone rule that holds, and where."""
    if place is None:
        return f"{link_id}: {zone}"
    position, frame = place.pose.position, place.header.frame_id or "map"
    return f"{link_id}: {zone} at {position.x:.2f} {position.y:.2f} in {frame}"


def forecast_message(record: LinkRecord, forecast: Forecast, factor: float) -> ForecastMessage:
    """A forecast, its value times a factor."""
    message = ForecastMessage(
        rnti=record.rnti or 0,
        link_id=record.link_id,
        value=forecast.value * factor,
        horizon_s=forecast.horizon_s,
        confidence=forecast.confidence,
    )
    message.header.stamp.FromNanoseconds(record.stamp_ns)
    return message
