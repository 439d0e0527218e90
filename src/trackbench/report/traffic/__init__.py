"""Reports of runs whose detections nobody labelled."""
