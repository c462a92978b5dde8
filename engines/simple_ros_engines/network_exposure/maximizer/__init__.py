"""As little of the network as the process needs: learn how much worse its topics may be before the score suffers."""
