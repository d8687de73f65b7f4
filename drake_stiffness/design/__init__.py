"""Which postures and loads to measure."""
