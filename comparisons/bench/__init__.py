"""The bench: what runs are made with, timed, kept and shown. It knows no study."""
