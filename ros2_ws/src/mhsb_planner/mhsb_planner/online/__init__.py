"""Goals as they come, replanning in motion and the hand-over of plans; free of ROS."""
