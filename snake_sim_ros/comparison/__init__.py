"""Speed against accuracy: the bench, its tables and charts, baselines and MuJoCo."""
