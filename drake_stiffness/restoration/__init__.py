"""The complete model from its identifiable part and limits of link sections."""
