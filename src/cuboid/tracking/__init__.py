"""The tracker: stages in the order of docs/method.md, poses, a result folder."""
