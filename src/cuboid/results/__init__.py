"""The results of a run: its files, views of them, exports to other programs."""
