"""The questions of the report: a module with a `STUDY` is one.

The others are what several of them, or sweeps, are made of: `study`, `work_precision`, `equal_error`,
`steady_state_measures`, `sweep`; `hold_data` has the runs of `hold`.
"""
