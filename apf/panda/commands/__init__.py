"""The work of the robot's commands, which the files of the same names in `apf/panda` start."""
