"""What changed since before: baselines, checks, nights and their history."""
