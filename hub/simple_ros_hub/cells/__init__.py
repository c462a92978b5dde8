"""Cells: small units that sense, send or drive, and keep to what engines and hub say."""

from simple_ros_hub.cells.cell import Cell, CellEvent, CellObserver, CellState

__all__ = ["Cell", "CellEvent", "CellObserver", "CellState"]
