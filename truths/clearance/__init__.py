"""Event-driven motions with impacts of a slider in a guide with clearance, independent of time stepping."""
