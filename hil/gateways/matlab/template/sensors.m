function [pose, scan] = sensors(vehicle, options)
% SENSORS  State and laser scan of the vehicle; with options.show they are drawn, and the camera if it has one.
  pose = vehicle.state();
  scan = vehicle.laser();
  if options.show
    show_laser(scan);
    show_camera(vehicle);
    drawnow();
  end
end

function show_laser(scan)
  persistent dots
  angles = scan.angle_min + (0:numel(scan.ranges) - 1).' * scan.angle_increment;
  x = scan.ranges .* sin(angles);    % to starboard
  y = scan.ranges .* cos(angles);    % ahead
  if isempty(dots) || ~ishandle(dots)
    subplot(1, 2, 1);
    dots = plot(x, y, '.');
    title('laser (m; ahead is up)');
    axis([-10 10 -10 10], 'square');
  else
    set(dots, 'XData', x, 'YData', y);
  end
end

function show_camera(vehicle)
  persistent missing shown
  if isequal(missing, true)
    return
  end
  try
    picture = vehicle.camera();
  catch
    missing = true;    % it has none
    return
  end
  if isempty(shown) || ~ishandle(shown)
    subplot(1, 2, 2);
    shown = image(picture);
    title('camera');
    axis('image', 'off');
  else
    set(shown, 'CData', picture);
  end
end
