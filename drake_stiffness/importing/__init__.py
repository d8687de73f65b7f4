"""Readings that other programs exported become a measurements.csv."""
