classdef PlannerRunner < uuv.PlannerSystem
  methods
    function varargout = run(self, varargin)
      [varargout{1:nargout}] = self.stepImpl(varargin{:});
    end
    function begin(self)
      self.setupImpl();
    end
  end
end
