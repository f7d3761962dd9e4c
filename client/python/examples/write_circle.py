"""A pen that writes circles of 2 cm until Ctrl-C: python write_circle.py."""

import math

import foretrace

with foretrace.attach() as ft, ft.pen(name="circle") as pen:
    for count in ft.pace(200):
        angle = 2.0 * math.pi * count / 400
        pen.send(0.02 * math.sin(angle), 0.02 * math.cos(angle), contact=True)
