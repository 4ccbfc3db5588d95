"""Run folders: writing, reading, reproduction and tracing of the data of a run."""
