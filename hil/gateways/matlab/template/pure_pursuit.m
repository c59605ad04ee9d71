function [command, along] = pure_pursuit(path, along, position, heading, options)
% PURE_PURSUIT  Speed and turn rate that follow a path (Coulter 1992): command.surge (m/s), yaw_rate (rad/s), aim (rad).
%
% along: how far the vehicle has come on the path (m), 0 at first; give back what was returned.
  here = reshape(position(1:2), 1, 2);
  ends = [0; cumsum(hypot(diff(path(:, 1)), diff(path(:, 2))))];
  along = nearest_on(path, ends, here, along, options.lookahead);
  ahead = point_at(path, ends, along + options.lookahead) - here;
  aim = atan2(ahead(2), ahead(1));
  turn = uuv.wrap(aim - heading);
  left = max(ends(end) - along, norm(path(end, :) - here));
  command.aim = aim;
  command.surge = options.speed * max(0, cos(turn)) * min(1, left / options.lookahead);
  command.yaw_rate = 2 * options.speed / options.lookahead * turn;
  command.yaw_rate = max(-options.max_yaw_rate, min(options.max_yaw_rate, command.yaw_rate));
end

function along = nearest_on(path, ends, here, along, reach)
  % The nearest place of the path, not far from the last one: a path may come near itself.
  low = max(0, along - reach);
  high = min(ends(end), along + reach);
  least = inf;
  for leg = 1:size(path, 1) - 1
    long = ends(leg + 1) - ends(leg);
    if long == 0 || ends(leg) > high || ends(leg + 1) < low
      continue
    end
    direction = (path(leg + 1, :) - path(leg, :)) / long;
    place = ends(leg) + dot(here - path(leg, :), direction);
    place = min([max([place, low, ends(leg)]), high, ends(leg + 1)]);
    distance = norm(here - (path(leg, :) + (place - ends(leg)) * direction));
    if distance < least
      least = distance;
      along = place;
    end
  end
end

function point = point_at(path, ends, along)
  leg = find(along < ends(2:end), 1);
  if isempty(leg)
    point = path(end, :);
    return
  end
  share = (along - ends(leg)) / (ends(leg + 1) - ends(leg));
  point = path(leg, :) + share * (path(leg + 1, :) - path(leg, :));
end
