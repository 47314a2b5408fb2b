"""One axis against a laser, a scale, a rotary calibrator or a level, target by target (ISO 230-2)."""
