"""The preview as docks of usdview, which finds plugInfo.json and loads `container`."""
