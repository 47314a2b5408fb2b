"""What was found about a machine, as corrections that its control can take, and what they will bring."""
