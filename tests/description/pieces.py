"""Pieces of a small good spacecraft, to be spoiled by the tests."""

BUS = """<robot name="bus">
  <link name="bus"><inertial><mass value="100"/>
    <inertia ixx="20" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="bus"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <link name="upper"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="mount" type="fixed"><parent link="bus"/><child link="arm_mount"/></joint>
  <link name="arm_mount"/>
</robot>
"""
HEAD = 'schema = 1\nname = "x"\nurdf = "bus.urdf"\n'
PANEL = """[[effect]]
kind = "beam_appendage"
name = "panel"
position = [1.0, 0.0, 0.0]
length = 2.0
width = 1.0
thickness = 0.002
density = 2700.0
youngs_modulus = 70e9
damping = 0.005
stations = [1.0]
"""
TANK = """[[effect]]
kind = "slosh"
name = "tank"
position = [0.0, 0.0, 0.0]
mass = 5.0
stiffness = [0.4, 0.4, 0.4]
damping = [0.0, 0.0, 0.0]
"""
SAIL = """[[effect]]
kind = "modal_appendage"
name = "sail"
position = [0.0, 0.0, 0.0]
mass = 5.0
center_of_mass = [1.0, 0.0, 0.0]
inertia = [0.1, 0.0, 7.0, 0.0, 0.0, 7.0]
[[effect.mode]]
frequency = 0.5
damping = 0.01
translation = [0.0, 0.0, 1.0]
rotation = [0.0, -1.0, 0.0]
"""
IMU = '[[sensor]]\nname = "imu"\nkind = "imu"\nrate = 100.0\n'
WHEEL = '[[wheel]]\nname = "w"\ninertia = 0.1\n'
ARM = '[[arm]]\nname = "arm"\n'
