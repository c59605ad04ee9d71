function [command, state] = local_planner(state, command, scan, heading, reach, options)
% LOCAL_PLANNER  Speed and turn rate that go round obstacles, by the vector field histogram VFH+ (Ulrich & Borenstein
% 1998), where pure pursuit would run into what the laser sees.
%
% command: that of pure_pursuit. scan: ranges (m, NaN: no echo), angle_min, angle_increment (rad from the bow). reach:
% what is farther (m) does not count, as it is beyond the goal. state: [] at first; give back what was returned.
% A sector takes the nearest obstacle in it; the speed falls with the turn and with the water ahead.
  width = 2 * pi / options.sectors;
  if isempty(state)
    state = struct('blocked', false(1, options.sectors), 'nearest', inf(1, options.sectors), 'last', NaN);
  end
  ranges = scan.ranges(:).';
  angles = scan.angle_min + (0:numel(ranges) - 1) * scan.angle_increment;
  centres = (0:options.sectors - 1) * width;
  middle = heading + 0.5 * (angles(1) + angles(end));
  half = 0.5 * (abs(angles(end) - angles(1)) + abs(scan.angle_increment));
  state.nearest(abs(uuv.wrap(centres - middle)) <= half) = inf;    % what is out of sight stays as it was
  echo = isfinite(ranges) & ranges > 0;
  for number = find(echo & ranges <= min(reach, options.range))
    spread = asin(min(1, options.radius / ranges(number)));
    hit = abs(uuv.wrap(centres - heading - angles(number))) <= spread;
    state.nearest(hit) = min(state.nearest(hit), ranges(number));
  end
  state.blocked = state.nearest < options.block_within | (state.blocked & state.nearest < options.free_beyond);
  state.last = choose(candidates(state.blocked, width, command.aim), command.aim, heading, state.last);
  if isnan(state.last)                                             % no way out: turn to look for one
    turn = uuv.wrap(command.aim - heading);
    command.surge = 0;
    command.yaw_rate = max(-options.max_yaw_rate, min(options.max_yaw_rate, turn));
    return
  end
  if any(state.blocked)
    turn = uuv.wrap(state.last - heading);
    command.yaw_rate = max(-options.max_yaw_rate, min(options.max_yaw_rate, turn));
    command.surge = min(command.surge, options.speed * max(0, cos(turn)));
  end
  ahead = ranges .* cos(angles);
  ahead = ahead(echo & abs(ranges .* sin(angles)) < options.radius & ahead > 0);
  room = (min([ahead inf]) - options.radius) / (options.block_within - options.radius);
  command.surge = command.surge * max(0, min(1, room));
end

function headings = candidates(blocked, width, aim)
  % Through the middle of narrow openings, along the sides of wide ones, and to the aim where that is free.
  wide = 0.8;
  headings = [];
  if ~any(blocked)
    headings = aim;
    return
  end
  count = numel(blocked);
  start = find(blocked, 1);
  turned = blocked(mod(start - 1 + (0:count), count) + 1);         % begins and ends with a blocked one
  first = find(diff(double(turned)) == -1) + 1;
  last = find(diff(double(turned)) == 1);
  for number = 1:numel(first)
    low = (start + first(number) - 2.5) * width;
    span = (last(number) - first(number) + 1) * width;
    if span <= wide
      headings(end + 1) = uuv.wrap(low + 0.5 * span);
      continue
    end
    headings = [headings, uuv.wrap(low + 0.5 * wide), uuv.wrap(low + span - 0.5 * wide)];
    inside = mod(aim - low, 2 * pi);
    if inside >= 0.5 * wide && inside <= span - 0.5 * wide
      headings(end + 1) = aim;
    end
  end
end

function chosen = choose(headings, aim, heading, last)
  chosen = NaN;
  if isempty(headings)
    return
  end
  cost = 5 * abs(uuv.wrap(headings - aim)) + 2 * abs(uuv.wrap(headings - heading));
  if ~isnan(last)
    cost = cost + 2 * abs(uuv.wrap(headings - last));
  end
  [~, best] = min(cost);
  chosen = headings(best);
end
