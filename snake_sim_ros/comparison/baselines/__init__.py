"""Regularized contact and the friction pyramid, to compare with."""
