function path = global_planner(map, start, goal)
% GLOBAL_PLANNER  The shortest path on a map by A*, [north east] m a row, from start to goal.
%
% Moves go to the 8 neighbours of a cell, and cut no corner; then the path is pulled straight. A start or a goal that
% is not free is replaced by the nearest free cell within 1 m of it.
  [rows, columns] = size(map.blocked);
  free = false(rows + 2, columns + 2);    % a border, so that no move needs to look for the edge
  free(2:end - 1, 2:end - 1) = ~map.blocked;
  height = rows + 2;
  source = free_cell(free, map, start, 'start');
  target = free_cell(free, map, goal, 'goal');
  north = [1 0 -1 0 1 1 -1 -1];
  east = [0 1 0 -1 1 -1 1 -1];
  moves = (north + height * east).';
  beside = [north.' height * east.'];     % of a diagonal move both must be free, too
  lengths = hypot(north, east).';
  [row, column] = ind2sub(size(free), (1:numel(free)).');
  [target_row, target_column] = ind2sub(size(free), target);
  far = abs(row - target_row);
  wide = abs(column - target_column);
  to_go = max(far, wide) + (sqrt(2) - 1) * min(far, wide);
  cost = inf(numel(free), 1);
  parent = zeros(numel(free), 1);
  cost(source) = 0;
  open = source;                          % cells that are to be looked at,
  keys = to_go(source);                   % and the length of a path over each, at least
  while true
    [least, place] = min(keys);
    if isempty(least)
      error('uuv:path', 'no path from (%.1f, %.1f) to (%.1f, %.1f) m: obstacles part them; try less clearance', ...
        start(1), start(2), goal(1), goal(2));
    end
    cell = open(place);
    if cell == target
      break
    end
    open(place) = open(end);
    keys(place) = keys(end);
    open(end) = [];
    keys(end) = [];
    if least > cost(cell) + to_go(cell) + 1e-9
      continue                            % a shorter path to it was found meanwhile
    end
    next = cell + moves;
    possible = free(next) & free(cell + beside(:, 1)) & free(cell + beside(:, 2));
    next = next(possible);
    reached = cost(cell) + lengths(possible);
    better = reached < cost(next) - 1e-9;
    next = next(better);
    reached = reached(better);
    cost(next) = reached;
    parent(next) = cell;
    open = [open; next];
    keys = [keys; reached + to_go(next)];
  end
  cells = cell;
  while parent(cells(end))
    cells(end + 1) = parent(cells(end));
  end
  cells = fliplr(cells);
  points = [map.south + (row(cells) - 1.5) * map.resolution, map.west + (column(cells) - 1.5) * map.resolution];
  path = pull_straight(map, points);
  if is_free(map, start)
    path(1, :) = start;
  end
  if is_free(map, goal)
    path(end, :) = goal;
  end
end

function cell = free_cell(free, map, point, what)
  [row, column] = find(free);
  distances = hypot(map.south + (row - 1.5) * map.resolution - point(1), ...
    map.west + (column - 1.5) * map.resolution - point(2));
  [least, nearest] = min(distances);
  if isempty(least) || least > 1
    error('uuv:path', 'the %s (%.1f, %.1f) m is not free, nor is anything within 1 m of it', what, point(1), point(2));
  end
  cell = sub2ind(size(free), row(nearest), column(nearest));
end

function path = pull_straight(map, points)
  % The points without those that can be left out on a straight line through free cells.
  path = points(1, :);
  here = 1;
  while here < size(points, 1)
    next = size(points, 1);
    while next > here + 1 && ~line_is_free(map, points(here, :), points(next, :))
      next = here + max(1, floor((next - here) / 2));
    end
    while next < size(points, 1) && line_is_free(map, points(here, :), points(next + 1, :))
      next = next + 1;
    end
    path(end + 1, :) = points(next, :);
    here = next;
  end
end

function free = line_is_free(map, from, to)
  count = max(2, ceil(norm(to - from) / (0.2 * map.resolution)));
  free = all(is_free(map, [linspace(from(1), to(1), count).' linspace(from(2), to(2), count).']));
end

function free = is_free(map, points)
  [rows, columns] = size(map.blocked);
  row = floor((points(:, 1) - map.south) / map.resolution) + 1;
  column = floor((points(:, 2) - map.west) / map.resolution) + 1;
  inside = row >= 1 & row <= rows & column >= 1 & column <= columns;
  free = inside;
  free(inside) = ~map.blocked(sub2ind([rows columns], row(inside), column(inside)));
end
