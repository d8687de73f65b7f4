"""Forces of milling: cutters, cutting laws, engagement, forces of teeth and their averages, and how depth and force drive each other.

Axes of everything in here ("cutter axes"): x along the feed of the tool, z along the tool's axis from tip to spindle, y completes
them - so y is to the left of the feed for someone who looks from the spindle. Forces act on the tool. See docs/milling.md.
"""
