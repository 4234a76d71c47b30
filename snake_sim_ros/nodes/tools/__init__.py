"""Programs around the nodes: the demo, measuring their pace, recording topics."""
