"""Set ζ of a running node: what `ros2 param set /rft medium.zeta 0.33` does, for cells without the `ros2` command."""

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

rclpy.init()
node = rclpy.create_node("setter")
client = node.create_client(SetParameters, "/rft/set_parameters")
client.wait_for_service()
parameters = [Parameter("medium.zeta", value=0.33).to_parameter_msg()]
future = client.call_async(SetParameters.Request(parameters=parameters))
rclpy.spin_until_future_complete(node, future)
print(future.result().results)  # successful, or the reason why not
