"""Stand-in for the ROS 2 package `launch_xml`."""
