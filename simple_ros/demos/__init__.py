"""The nodes of ``simple-ros demo``, and what starts and shows them."""
