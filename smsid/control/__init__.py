"""Control: model-based PD and H-infinity on the reduced dynamics, and what identification is worth."""
