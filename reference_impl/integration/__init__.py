"""Motion in time: event-driven with frozen contact modes, the paper's fixed-step scheme, Moreau's time stepping."""
