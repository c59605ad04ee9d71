function map = known_map(vehicle, options)
% KNOWN_MAP  The map of the vehicle's world, as its scenario has it, with all that is too near to an obstacle.
%
% map: blocked (logical; rows to the north, columns to the east), occupied (the same without the clearance), south,
% west (m, where the first cell begins), resolution (m).
  map = vehicle.map();
  reach = floor(options.clearance / map.resolution + 1e-9);
  [rows, columns] = ndgrid(-reach:reach);
  disc = hypot(rows, columns) * map.resolution <= options.clearance + 1e-9;
  map.blocked = conv2(double(map.occupied), double(disc), 'same') > 0.5;
end
