"""Small jobs of the tests."""

# A plate with a metal ball, a lid and a screen of light behind a camera from above. Two lamps.
STATION = """
scene = "none"
seed = 3

[film]
width = {width}
height = {height}

[camera]
position = [0, "300mm", 0]
look_at = [0, 0, 0]
up = [0, 0, -1]
vertical_fov = "30deg"

[sensor]
model = "imx250"
{sensor}

[[object]]
name = "plate"
kind = "box"
size = ["300mm", "4mm", "300mm"]
translate = [0, "-2mm", 0]

[[object]]
name = "ball"
kind = "sphere"
diameter = "50mm"
translate = ["-40mm", "25mm", 0]

[[object]]
name = "lid"
kind = "box"
size = ["50mm", "10mm", "50mm"]
translate = ["40mm", "5mm", 0]

[[material]]
name = "plate"
base_color = 0.4
roughness = 0.8

[[material]]
name = "ball"
base_color = [0.9, 0.8, 0.6]
metallic = 1
roughness = 0.3

[[light]]
name = "left"
kind = "panel"
width = "60mm"
height = "60mm"
position = ["-150mm", "200mm", 0]
target = [0, 0, 0]
power = {left}

[[light]]
name = "right"
kind = "panel"
width = "60mm"
height = "60mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = 0.5
{more}
"""


def station(width=96, height=72, sensor='exposure = "auto"', left=0.5, more=""):
    """The text of a job."""
    return STATION.format(width=width, height=height, sensor=sensor, left=left, more=more)


# A sensor with a colour filter, a fixed pattern, dark current and defects. Its numbers are invented.
COLOUR_SENSOR = """
name = "colour"
source = "invented for a test"
bit_depth = 10
pixel_pitch_um = 3.45
full_well_e = 9000
dark_noise_e = 3
gain_e_per_dn = 10
offset_dn = 20
dsnu_e = 4
prnu_percent = 2

[color_filter]
pattern = "grbg"
red = [[465, 0.04], [550, 0.06], [610, 0.45]]
green = [[465, 0.15], [530, 0.58], [610, 0.1]]
blue = [[465, 0.52], [550, 0.12], [610, 0.04]]

[dark_current]
e_per_s = 200
at_c = 25
doubling_k = 7

[defects]
hot_per_million = 500
dead_per_million = 500
"""
