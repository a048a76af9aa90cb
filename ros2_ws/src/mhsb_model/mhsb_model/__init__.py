"""Machine model of a hydraulic manipulator with booster modules; knows no ROS."""
