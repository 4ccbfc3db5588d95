"""Truths by integration in minimal coordinates, with an uncertainty from two discretizations."""
