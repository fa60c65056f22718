"""Commands of the OPC UA server."""
