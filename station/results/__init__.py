"""From records to what they say: metrics and verdict, replay, what-if, export."""
