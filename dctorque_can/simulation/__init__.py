"""Reference plant, gearbox control, drives and sensors. Shares no code with the estimators."""
