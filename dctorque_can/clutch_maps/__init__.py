"""The torque that each clutch carries by its position, pressure or command, learned from the estimates."""
