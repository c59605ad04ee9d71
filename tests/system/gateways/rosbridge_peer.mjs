// What roslibjs sees and does through rosbridge, as a web page has it: node rosbridge_peer.mjs ADDRESS. Prints JSON.
import { Param, Ros, Service, Topic } from "roslib";

const ros = new Ros({ url: process.argv[2] });
const found = {};
const once = (name, messageType, compression, fits = () => true) => new Promise((resolve) => {
  const topic = new Topic({ ros, name, messageType, compression });
  topic.subscribe((message) => { if (fits(message)) { topic.unsubscribe(); resolve(message); } });
});
const ask = (call) => new Promise((resolve, reject) => call(resolve, reject));

ros.on("error", (error) => { console.error(error); process.exit(1); });
ros.on("connection", async () => {
  found.topics = (await ask((yes, no) => ros.getTopics(yes, no))).topics;
  found.services = await ask((yes, no) => ros.getServices(yes, no));
  found.types = ros.decodeTypeDefs(await ask((yes, no) => ros.getMessageDetails("geometry_msgs/Twist", yes, no)));
  found.json = (await once("/uuv1/imu", "sensor_msgs/Imu", "none")).linear_acceleration;
  // One in JSON may still be on its way from the subscription before.
  const isPacked = (message) => !Array.isArray(message.linear_acceleration_covariance);
  const imu = await once("/uuv1/imu", "sensor_msgs/Imu", "cbor", isPacked);
  found.cbor = [imu.linear_acceleration_covariance.constructor.name, imu.linear_acceleration_covariance[0]];
  const gain = new Param({ ros, name: "/uuv1:gains.surge.p" });
  const before = await ask((yes) => gain.get(yes));
  await ask((yes, no) => gain.set(before + 1, yes, no));
  found.raised = (await ask((yes) => gain.get(yes))) - before;
  const arm = new Service({ ros, name: "/uuv1/arm", serviceType: "std_srvs/SetBool" });
  found.armed = await ask((yes, no) => arm.callService({ data: true }, yes, no));
  const command = new Topic({ ros, name: "/uuv1/cmd_vel", messageType: "geometry_msgs/Twist" });
  const timer = setInterval(() => command.publish({ linear: { x: 0.5, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0 } }), 50);
  await new Promise((resolve) => {
    new Topic({ ros, name: "/uuv1/ground_truth", messageType: "nav_msgs/Odometry" }).subscribe((message) => {
      found.speed = message.twist.twist.linear.x;
      if (found.speed > 0.3) resolve();
    });
  });
  clearInterval(timer);
  process.stdout.write(JSON.stringify(found), () => process.exit(0));
});
