"""The hub: starts and watches the wireless engines and cells, shares out the radio, chooses the policy."""
