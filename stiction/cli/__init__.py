"""The command line `stiction`; commands import what they need when called, so that ``--help`` answers at once."""
