"""What several protocols do with the torque: its zero, the tare, running torque per hold, its pattern over a turn."""
