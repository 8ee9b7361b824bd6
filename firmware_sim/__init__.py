"""The device's node: a simulated controller with an arm and an actuator. It imports nothing of hilbridge."""
