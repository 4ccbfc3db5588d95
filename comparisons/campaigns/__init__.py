"""Many runs in one go, kept, compared with a baseline: validation, nights, checks."""
