"""The parts of the torque law: what it remembers, its filters, damping, guidance and gravity support. torque.py joins them."""
