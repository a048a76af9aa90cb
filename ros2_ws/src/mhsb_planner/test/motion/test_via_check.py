"""Points that a motion passes, in their order."""

import numpy as np

from mhsb_planner.motion.via_check import describe_first_missed, find_points_ahead

TIP = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])


def test_points_near_the_lines_between_tips_are_passed():
    assert describe_first_missed(TIP, ()) == ""
    assert describe_first_missed(TIP, ((0.5, 0.01, 0.011), (1.01, 0.5, 0.011))) == ""
    assert describe_first_missed(TIP, ((0.5, 0.01, 0.011), (0.8, 0.0, 0.001))) == ""


def test_the_first_point_that_is_missed_is_named_with_its_distance():
    sentence = describe_first_missed(TIP, ((0.5, 0.0, 0.01), (0.5, 0.1, 0.01)))
    assert sentence == "the tip passes (0.5, 0.1) m at 100 mm, at most 10 mm is allowed"


def test_points_are_passed_in_their_order():
    assert "(0.5, 0) m" in describe_first_missed(TIP, ((1.0, 0.5, 0.01), (0.5, 0.0, 0.01)))


def test_a_motion_that_rests_passes_where_it_is():
    assert describe_first_missed(TIP[:1], ((0.0, 0.001, 0.01),)) == ""
    assert "100 mm" in describe_first_missed(TIP[:1], ((0.0, 0.1, 0.01),))


def test_points_that_have_been_passed_in_their_order_lie_ahead_no_more():
    passing = ((0.5, 0.01, 0.011), (1.0, 0.5, 0.01), (0.2, 0.0, 0.01))
    assert find_points_ahead(TIP, passing) == passing[2:]
    assert find_points_ahead(TIP[:2], passing) == passing[1:]
    assert find_points_ahead(TIP[:1], passing) == passing
    assert find_points_ahead(TIP, ()) == ()


def test_a_point_at_the_edge_of_its_tolerance_counts_as_passed():
    assert find_points_ahead(TIP, ((0.5, 0.0101, 0.01),)) == ()
    assert describe_first_missed(TIP, ((0.5, 0.0101, 0.01),)) != ""
