"""Measurements that are simulated."""
