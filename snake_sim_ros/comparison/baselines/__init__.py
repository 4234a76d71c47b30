"""Regularized contact and the friction pyramid, with which our methods are compared."""
