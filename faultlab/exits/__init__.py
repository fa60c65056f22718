"""Every fault in every state, followed to where the bench comes to rest."""
