"""A main pump whose pressure falls for a while, as when another user draws on it."""

from __future__ import annotations

from mhsb_model.schema import SupplySag


def sagging_pressure(nominal: float, sag: SupplySag, time: float) -> float:
    """Pressure [Pa] that the pump keeps at `time` [s]: down, there and back, linear in between."""
    since = time - sag.start
    left = sag.fall + sag.duration + sag.fall - since
    share = min(since, left) / sag.fall
    return nominal + min(max(share, 0.0), 1.0) * (sag.pressure - nominal)
