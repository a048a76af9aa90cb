"""Commands that a user starts beside the nodes: plan, simulate, record, report, study and more."""

from typing import TYPE_CHECKING

from mhsb_model import import_on_use

if TYPE_CHECKING:
    from mhsb_tools.moves.move import move_of_plan as move_of_plan
    from mhsb_tools.moves.move_page import draw_move_page as draw_move_page
    from mhsb_tools.moves.move_page import plot_plan as plot_plan
    from mhsb_tools.moves.supply_systems import compute_single_supply as compute_single_supply
    from mhsb_tools.recording.bag_reader import read_recording as read_recording

__getattr__, __dir__ = import_on_use(
    __name__,
    {
        "move_of_plan": "mhsb_tools.moves.move",
        "draw_move_page": "mhsb_tools.moves.move_page",
        "plot_plan": "mhsb_tools.moves.move_page",
        "compute_single_supply": "mhsb_tools.moves.supply_systems",
        "read_recording": "mhsb_tools.recording.bag_reader",
    },
)
