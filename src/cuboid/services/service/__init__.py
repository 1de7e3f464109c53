"""A place that answers other programs: over HTTP, a WebSocket, and MCP."""
