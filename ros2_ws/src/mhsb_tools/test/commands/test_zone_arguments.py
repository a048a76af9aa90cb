"""Zones on the command line: those of the arm, beside its own, and what it cannot have."""

import re

import pytest

from mhsb_model.command_line import UsageError, run
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_tools.commands.zone_arguments import ZoneArguments, add_zones

BOX = (-1.0, 1.5, -0.5, 0.5, 2.0, 0.0)
CYLINDER, SPHERE = (-1.5, -0.5, -1.0, 1.0, 0.1), (1.0, -1.0, 0.5, 0.2)


@pytest.fixture(scope="module")
def excavator():
    return load_machine(find_config_file("excavator.yaml"))


def test_zones_are_read_in_their_order_with_negative_numbers():
    found = {}

    def command(zones: ZoneArguments) -> None:
        """Take zones."""
        found.update(vars(zones))

    words = (
        "--zone-box -1 1.5 -0.5 0.5 2 0 --zone-cylinder -1.5 -0.5 -1 1 0.1 --zone-box -1 -2 3 4 "
        "--zone-sphere 1 -1 0.5 0.2"
    )
    assert run(command, words.split(), name="command") == 0
    assert found == {
        "zone_box": (BOX, (-1.0, -2.0, 3.0, 4.0)),
        "zone_circle": (),
        "zone_cylinder": (CYLINDER,),
        "zone_sphere": (SPHERE,),
    }


def test_they_stand_beside_those_of_the_machine_file(excavator, machine):
    own = excavator.changed(zones=Zones(tip_spheres=(SPHERE,)))
    found = add_zones(own, boxes=(BOX,), circles=(), cylinders=(CYLINDER,), spheres=(SPHERE,))
    assert found.zones == Zones(
        boxes=(BOX,), cylinders=(CYLINDER,), spheres=(SPHERE,), tip_spheres=(SPHERE,)
    )
    planar = add_zones(machine, boxes=((0.7, -0.1, 0.9, 0.2),), circles=((0.4, 0.8, 0.1),))
    assert planar.zones == Zones(boxes=((0.7, -0.1, 0.9, 0.2),), circles=((0.4, 0.8, 0.1),))
    assert add_zones(machine, boxes=(), circles=()).table_hash == machine.table_hash


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            {"boxes": ((0.7, 0.1, 0.9, 0.3),)},
            "--zone-box: excavator slews and takes X1 Y1 Z1 X2 Y2 Z2, not 0.7 0.1 0.9 0.3",
        ),
        ({"boxes": ((),)}, "takes X1 Y1 Z1 X2 Y2 Z2, not nothing"),
        (
            {"circles": ((0.4, -0.8, 0.1),)},
            "--zone-circle 0.4 -0.8 0.1: excavator slews; give --zone-box X1 Y1 Z1 X2 Y2 Z2 or "
            "--zone-cylinder X Y Z_MIN Z_MAX RADIUS or --zone-sphere X Y Z RADIUS",
        ),
        ({"spheres": ((1.0, 0.0, 0.0, -0.2),)}, "radius: must be at least 0.0001 m (is -0.2)"),
    ],
)
def test_what_an_arm_that_slews_cannot_have_is_refused_with_what_it_can(excavator, given, sentence):
    with pytest.raises(UsageError, match=re.escape(sentence)):
        add_zones(excavator, **given)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            {"boxes": (BOX,)},
            "--zone-box: mhsb_arm3 does not slew and takes X1 Z1 X2 Z2, not -1 1.5 -0.5 0.5 2 0",
        ),
        (
            {"cylinders": (CYLINDER,)},
            "--zone-cylinder -1.5 -0.5 -1 1 0.1: mhsb_arm3 does not slew; give --zone-box "
            "X1 Z1 X2 Z2 or --zone-circle X Z RADIUS",
        ),
        ({"spheres": (SPHERE,)}, "--zone-sphere 1 -1 0.5 0.2: mhsb_arm3 does not slew; give"),
    ],
)
def test_what_an_arm_in_a_plane_cannot_have_is_refused_with_what_it_can(machine, given, sentence):
    with pytest.raises(UsageError, match=re.escape(sentence)):
        add_zones(machine, **given)
