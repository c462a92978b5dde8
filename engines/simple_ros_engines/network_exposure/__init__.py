"""Network Exposure: tagged topics get their quality of service from the mobile network by themselves."""
