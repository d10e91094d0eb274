"""Pictures of detections, and reports in one HTML file that opens without a network."""
