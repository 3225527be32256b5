"""The loop between a controller and the plant: sensors, motors, clock, disturbances and supervisors; domains."""
