"""The controller as portable C11, its generated tables, and the binding that lets the simulator run it."""
