"""Settings for one wearer from their recordings: tau_on, and profiles by trials on the simulated arm. Nothing is widened."""
