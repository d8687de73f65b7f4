"""Many jobs of the command line: on the cores of this machine or on a cluster, resumed where they stopped."""
