"""``python -m semmap_ros --ros-args -p map:=house``: the node, without an installed ROS."""

from semmap_ros.node import main

main()
