% A loop of a fixed rate, which counts its late cycles.
%
%   rate = uuv.Rate(20);                 % Hz
%   while ~done
%     ...
%     rate.wait();                       % until the next cycle is due
%   end
%   rate.late / rate.cycles              % share of the cycles that began late
%
% A cycle is late if it begins more than a tenth of a period after it was due. After a delay of more than a period
% the cycles that were missed count as late, and are left out.
classdef Rate < handle
  properties (SetAccess = private)
    period
    cycles = 0;
    late = 0;
    worst = 0;     % s after it was due, of all cycles
  end

  properties (Access = private)
    began
    due = 0;
  end

  methods
    function self = Rate(hertz)
      self.period = 1 / hertz;
      self.began = tic;
    end

    function wait(self)
      self.due = self.due + self.period;
      left = self.due - toc(self.began);
      if left > 0
        pause(left);
      end
      delay = toc(self.began) - self.due;
      missed = max(0, floor(delay / self.period));
      self.due = self.due + missed * self.period;
      self.cycles = self.cycles + 1 + missed;
      self.late = self.late + missed + (delay - missed * self.period > 0.1 * self.period);
      self.worst = max(self.worst, delay);
    end

    function restart(self)
      % Begin again after work that takes long on purpose; what was counted stays.
      self.began = tic;
      self.due = 0;
    end
  end
end
