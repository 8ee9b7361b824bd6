"""What a run says of itself: rows of the device as heard, judgements, losses, notices. Pure."""
