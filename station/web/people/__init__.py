"""Who is there and what they did: accounts, sessions, audit."""
