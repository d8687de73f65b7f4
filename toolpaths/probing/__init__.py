"""The closed loop: what a probe found on the cut part, taken apart and fed back."""
