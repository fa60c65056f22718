"""What recipe, bench and calibration files may say."""
