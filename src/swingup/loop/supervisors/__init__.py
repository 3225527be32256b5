"""What stands beside a controller in a loop and stops, throws, moves or kicks the pendulum."""
