"""Planning, execution, timing, storage and presentation of runs; nothing here is specific to a study."""
