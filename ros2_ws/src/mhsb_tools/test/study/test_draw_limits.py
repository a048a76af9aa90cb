from dataclasses import replace

from mhsb_tools.study.draw_limits import as_text, compute_figures
from mhsb_tools.study.draws import DrawRecord

BASE = DrawRecord(
    "coordinated", 0, {}, tip_error_rms_mm=1.0, tip_error_max_mm=4.0, supply_overshoot_mpa=0.1,
    relief_opened=False, time_lost=0.1, interventions=1, rho_s=0.005, later_percent=1.0,
    rest_error_mm=0.2, spool_deviation_percent=0.1, flow_suffices=True, payload_kg=10.0,
    payload_half_interval_kg=1.0, payload_error_percent=3.0, payload_holds=True,
)  # fmt: skip


def test_every_figure_stands_beside_its_limit() -> None:
    records = [replace(BASE, draw=k) for k in range(19)]
    records += [
        replace(BASE, draw=19, tip_error_max_mm=30.0, later_percent=90.0, flow_suffices=False,
                payload_holds=False, relief_opened=True),
        DrawRecord("coordinated", 20, {}, failure="it diverged"),
    ]  # fmt: skip
    found = {figure.name: figure for figure in compute_figures(records)}
    assert found["tip error, largest [mm], worst"].value == 30.0
    assert not found["tip error, largest [mm], worst"].is_within_limits
    assert found["tip error, RMS [mm], p95"].is_within_limits
    later = found["arrival later, where flow suffices [%], p95"]
    assert (later.value, later.runs) == (1.0, 19)
    assert found["arrival later, all [%], worst"].value == 90.0
    assert found["95 % interval holds it [% of draws]"].value == 95.0
    assert found["95 % interval holds it [% of draws]"].is_within_limits
    assert not found["relief valve opened [draws]"].is_within_limits
    assert not found["failed [draws]"].is_within_limits
    lines = as_text(records)
    assert any("tip error, largest" in line and line.endswith("not held") for line in lines)
    assert lines[-1] == "draw 20: it diverged"


def test_what_no_run_tells_is_left_out() -> None:
    silent = replace(BASE, payload_kg=None, payload_error_percent=None, payload_holds=None)
    names = [figure.name for figure in compute_figures([silent])]
    assert not any("payload" in name or "interval" in name for name in names)
