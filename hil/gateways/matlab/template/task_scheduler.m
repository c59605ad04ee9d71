function [goal, state] = task_scheduler(state, tasks, time, position, options)
% TASK_SCHEDULER  The place to go to, [north east] m, or [] to stay; state.done once all tasks are done.
%
% A task is ready when what it needs is finished; of those that are ready the nearest is next. At its place the vehicle
% stays for its duration. state: [] at first; then finished (names, in order), task (number, 0: none), since (s, when
% it came there; NaN: on its way), done.
  if isempty(state)
    state = struct('finished', {{}}, 'task', 0, 'since', NaN, 'done', false);
  end
  here = reshape(position(1:2), 1, 2);
  if state.task && isnan(state.since) && norm(tasks(state.task).at - here) <= options.tolerance
    state.since = time;
  end
  if state.task && time - state.since >= tasks(state.task).duration
    state.finished{end + 1} = tasks(state.task).name;
    state.task = 0;
    state.since = NaN;
  end
  if ~state.task
    state.task = nearest_ready(tasks, state.finished, here);
  end
  state.done = numel(state.finished) == numel(tasks);
  goal = [];
  if state.task
    goal = tasks(state.task).at;
  elseif ~state.done
    waiting = setdiff({tasks.name}, state.finished);
    error('uuv:tasks', 'no task can begin any more; these wait for others: %s', strjoin(waiting, ', '));
  end
end

function chosen = nearest_ready(tasks, finished, here)
  chosen = 0;
  least = inf;
  for number = 1:numel(tasks)
    task = tasks(number);
    ready = ~any(strcmp(task.name, finished)) && (isempty(task.needs) || any(strcmp(task.needs, finished)));
    if ready && norm(task.at - here) < least
      least = norm(task.at - here);
      chosen = number;
    end
  end
end
