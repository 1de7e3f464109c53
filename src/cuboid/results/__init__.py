"""What a run leaves: its files, views of them, exports to other programs."""
