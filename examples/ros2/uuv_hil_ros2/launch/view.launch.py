"""Show a vehicle of uuv-hil in RViz: `ros2 launch uuv_hil_ros2 view.launch.py`.

Needs `uuv-hil` on the path, which writes the vehicle's URDF for its joints' transforms.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = (
    ("node", "uuv1", "name of the vehicle's node"),
    ("vehicle", "paper_six", "the vehicle: a preset of uuv-hil, or its .toml file"),
    ("router", "tcp/localhost:7447", "where the slave, rmw_zenohd or uuv-hil router listens"),
)


def generate_launch_description() -> LaunchDescription:
    """Start robot_state_publisher and RViz."""
    node, vehicle, router = (LaunchConfiguration(name) for name, _, _ in ARGUMENTS)
    urdf = ParameterValue(Command(["uuv-hil vehicle ", vehicle, " --urdf"]), value_type=str)
    view = PathJoinSubstitution([FindPackageShare("uuv_hil_ros2"), "rviz", "vehicle.rviz"])
    return LaunchDescription(
        [
            *[DeclareLaunchArgument(name, default_value=value, description=about) for name, value, about in ARGUMENTS],
            SetEnvironmentVariable("RMW_IMPLEMENTATION", "rmw_zenoh_cpp"),
            SetEnvironmentVariable("ZENOH_CONFIG_OVERRIDE", ['connect/endpoints=["', router, '"]']),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                namespace=node,
                parameters=[{"robot_description": urdf}],
                remappings=[("robot_description", "robot_state_description")],
            ),
            Node(package="rviz2", executable="rviz2", arguments=["-d", view]),
        ]
    )
