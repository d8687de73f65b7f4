"""Plants that stand for real robots: independent of the packages that are tried on them.

Nothing here imports `drake_stiffness` or `toolpaths`. Put `examples/` on the import path and `import plants`.
"""
