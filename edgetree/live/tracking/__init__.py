"""Stems followed over time in three dimensions, and their measurements fused."""
