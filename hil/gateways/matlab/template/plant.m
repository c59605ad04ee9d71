function plant(vehicle, command, options)
% PLANT  Give the vehicle its speed (m/s) and its turn rate (rad/s); it holds the depth by itself.
  vehicle.drive('surge', command.surge, 'yaw_rate', command.yaw_rate, 'depth', options.depth);
end
