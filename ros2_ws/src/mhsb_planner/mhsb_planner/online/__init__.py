"""Handling of goals while the arm moves: replanning, hand-over of plans and stops; without ROS."""
