"""Shows a robot in RViz, with a slider for each joint.

ros2 launch irbcal_description display.launch.py robot:=irb120
ros2 launch irbcal_description display.launch.py kinematics_params:=$PWD/my-robot/joint_origins.yaml
ros2 launch irbcal_description display.launch.py model:=$PWD/my-robot/calibrated.urdf
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """The robot's state, sliders for its joints, and RViz."""
    share = FindPackageShare("irbcal_description")
    robot = LaunchConfiguration("robot")
    arguments = [
        DeclareLaunchArgument("robot", default_value="irb1600", description="irb1600 or irb120"),
        DeclareLaunchArgument(
            "kinematics_params",
            default_value=PathJoinSubstitution([share, "config", robot, "joint_origins.yaml"]),
            description="Joint origins: a calibration's joint_origins.yaml (whole path)",
        ),
        DeclareLaunchArgument(
            "model",
            default_value=[PathJoinSubstitution([share, "urdf", robot]), ".urdf.xacro"],
            description="URDF or xacro file in place of the robot's own (whole path)",
        ),
    ]
    described = Command(
        [
            "xacro '",
            LaunchConfiguration("model"),
            "' 'kinematics_params:=",
            LaunchConfiguration("kinematics_params"),
            "'",
        ]
    )
    return LaunchDescription(
        [
            *arguments,
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(described, value_type=str)}],
            ),
            Node(package="joint_state_publisher_gui", executable="joint_state_publisher_gui"),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([share, "rviz", "display.rviz"])],
            ),
        ]
    )
