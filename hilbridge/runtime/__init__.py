"""The running bridge: the only scheduler and the only place that reads the clock."""
