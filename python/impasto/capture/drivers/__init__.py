"""Devices for :func:`impasto.capture.run`; each file needs its library only when it is used.

``simulated``: a simulated painting, with misfires on demand. ``gphoto2_camera``: cameras that
libgphoto2 knows. ``dome``: lamps behind a serial port. ``by_hand``: a person releases and switches.
"""
