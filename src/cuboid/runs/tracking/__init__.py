"""The tracker: its stages in the order of docs/method.md, poses, and the result folder."""
