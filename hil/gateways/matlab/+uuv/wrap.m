function angle = wrap(angle)
% WRAP  An angle (rad) between -pi and pi.
  angle = mod(angle + pi, 2 * pi) - pi;
end
