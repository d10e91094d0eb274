"""CoIn3D: multi-camera 3D object detection that transfers to camera rigs it was never trained on."""
