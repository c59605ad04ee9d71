classdef System < handle
end
