"""Bags of ROS 2 (MCAP, rosbag2), written, mended and read without ROS; also bags from strangers.

`ros_bag.writing.BagWriter` writes a bag, `ros_bag.recovery.recover` finishes one after a kill, `ros_bag.reading.Bag`
reads it, and README.md is the manual. This module stays empty, because a recorder must not load numpy.
"""
