"""What is timed, and against what: a plain reference implementation and the limit of the machine."""
