% Time stepping of planar mechanisms with dry friction, in GNU Octave.
%
% Moreau's midpoint rule. In a step of length h from (q, v), with m = q + h v/2 and p = q + h v, the next velocity w and
% the impulses L of joints and drives and P of friction solve
%     M (w - v) = h Q(t + h/2, m, v) + J(m)' L + T(m)' P,   J(p) w = -dPhi/dt - Phi(q) / (10 h),   |P| <= mu load,
% load of the corners of a slider: max(|R|, 2 |N| / length) of its own impulses L;   q <- q + h (v + w) / 2.
1;  % a script, not a function file

% laws of time

function [value, rate] = law_at(law, t)
  switch law.type
    case "constant", value = law.value; rate = 0;
    case "linear", value = law.offset + law.rate * t; rate = law.rate;
    case "sine"
      phase = law.frequency * t + law.phase;
      value = law.offset + law.amplitude * sin(phase); rate = law.amplitude * law.frequency * cos(phase);
    case "table"
      x = law.times(:); y = law.values(:); n = numel(x); b = zeros(n, 1);
      cubic = strcmp(law.interpolation, "cubic");
      if cubic && n > 2  % second derivatives of the natural cubic spline
        s = diff(x);
        A = diag(2 * (s(1:end-1) + s(2:end))) + diag(s(2:end-1), 1) + diag(s(2:end-1), -1);
        b(2:end-1) = A \ (6 * diff(diff(y) ./ s));
      end
      i = min(max(sum(x <= t), 1), n - 1);
      h = x(i+1) - x(i); slope = (y(i+1) - y(i)) / h; u = t - x(i); s = x(i+1) - t;
      if t < x(1) || t >= x(end)  % the end value, or the end's tangent
        if t < x(1), k = 1; bend = -2 * b(1) - b(2); else, k = n; bend = b(n-1) + 2 * b(n); end
        rate = cubic * (slope + h / 6 * bend);
        value = y(k) + rate * (t - x(k));
      else
        value = (b(i) * s^3 + b(i+1) * u^3) / (6*h) + (y(i)/h - b(i)*h/6) * s + (y(i+1)/h - b(i+1)*h/6) * u;
        rate = (b(i+1) * u^2 - b(i) * s^2) / (2*h) + slope - h/6 * (b(i+1) - b(i));
      end
  end
end

% mechanics

function at = place(bodies, name)  % of a body among the coordinates; empty for the ground
  at = [];
  if !strcmp(name, "ground"), at = 3 * find(strcmp(bodies, name)) - 2 + (0:2); end
end

function c = between(bodies, one, other, kind, points, axis, law)
  c = struct("a", place(bodies, one), "b", place(bodies, other), "angle", any(strcmp(kind, {"angle", "torsional"})));
  c.points = points; c.axis = axis(:); c.law = law;
end

function p = turned(angle, point)
  p = [cos(angle), -sin(angle); sin(angle), cos(angle)] * point(:);
end

function [value, row] = coordinate(c, q)  % angle or distance between two bodies, and its derivatives
  row = zeros(1, numel(q)); a = b = zeros(3, 1);
  if c.a, a = q(c.a); end
  if c.b, b = q(c.b); end
  if c.angle
    value = a(3) - b(3); one = [0 0 1]; other = [0 0 -1];
  else
    arm = turned(a(3), c.points(1, :)); there = a(1:2) + arm - b(1:2);
    apart = there - turned(b(3), c.points(2, :));
    if isempty(c.axis), e = apart; else, e = turned(b(3), c.axis); end
    e = e / max(norm(e), realmin);
    value = e' * apart;
    one = [e', arm(1) * e(2) - arm(2) * e(1)]; other = -[e', there(1) * e(2) - there(2) * e(1)];
  end
  if c.a, row(c.a) = one; end
  if c.b, row(c.b) = other; end
end

function rows = rows_of(coordinates, q)
  rows = zeros(numel(coordinates), numel(q));
  for k = 1:numel(coordinates), [~, rows(k, :)] = coordinate(coordinates{k}, q); end
end

function s = read_scene(scene)
  s.names = fieldnames(scene.bodies)'; zero = struct("type", "constant", "value", 0);
  b = struct2cell(scene.bodies)'; s.rows = s.guides = s.springs = s.loads = {};
  s.mass = cell2mat(cellfun(@(b) [b.mass; b.mass; b.inertia], b', "UniformOutput", false));
  s.q = cell2mat(cellfun(@(b) [b.position(:); b.angle], b', "UniformOutput", false));
  s.v = cell2mat(cellfun(@(b) [b.velocity(:); b.angular_velocity], b', "UniformOutput", false));
  s.weight = s.mass .* repmat([scene.gravity(:); 0], numel(b), 1); s.frictions = {};
  for name = fieldnames(scene.joints)'
    joint = scene.joints.(name{1});
    if strcmp(joint.type, "revolute")
      for axis = eye(2)
        s.rows{end+1} = between(s.names, joint.bodies{:}, "distance", joint.points, axis, zero);
      end
      continue
    end
    d = joint.direction; points = [joint.slider_point(:)'; joint.point(:)'];
    make = @(kind, axis, law) between(s.names, joint.slider, joint.guide, kind, points, axis, law);
    if ~isempty(joint.mu)
      joint.slip = make("distance", d, zero); joint.normal = numel(s.rows) + 1;
      s.guides{end+1} = joint; s.frictions{end+1} = name{1};
    end
    s.rows{end+1} = make("distance", [-d(2), d(1)], zero);
    s.rows{end+1} = make("angle", [], struct("type", "constant", "value", joint.angle));
  end
  for drive = struct2cell(scene.drives)'
    d = drive{1}; s.rows{end+1} = between(s.names, d.bodies{:}, d.type, d.points, d.axis, d.law);
  end
  for spring = struct2cell(scene.springs)'
    k = spring{1};
    if strcmp(k.type, "torsional"), k.points = k.axis = []; k.rest_length = k.rest_angle; end
    k.along = between(s.names, k.bodies{:}, k.type, k.points, k.axis, zero); s.springs{end+1} = k;
  end
  for load = struct2cell(scene.forces)', load{1}.at = place(s.names, load{1}.body); s.loads{end+1} = load{1}; end
end

function Q = forces(s, t, q, v)
  Q = s.weight;
  for k = 1:numel(s.springs)
    spring = s.springs{k}; [d, row] = coordinate(spring.along, q);
    Q -= row' * (spring.stiffness * (d - spring.rest_length) + spring.damping * row * v);
  end
  for k = 1:numel(s.loads)
    load = s.loads{k}; size = law_at(load.law, t);
    if strcmp(load.type, "torque"), Q(load.at(3)) += size; continue, end
    f = size * load.direction(:) / norm(load.direction); arm = turned(q(load.at(3)), load.point);
    Q(load.at) += [f; arm(1) * f(2) - arm(2) * f(1)];
  end
end

function most = bound(guide, mu, sign, impulses)  % mu times the load of the corners
  R = impulses(1); N = impulses(2); most = mu * abs(R);
  if ~isempty(guide.length), most = mu * max(abs(R), 2 * abs(N - guide.width / 2 * sign * mu * R) / guide.length); end
end

function [w, P] = step(s, t, h)  % velocity after a step, and its friction impulses
  n = numel(s.q); m = numel(s.rows); middle = s.q + h / 2 * s.v; ahead = s.q + h * s.v;
  slip = cellfun(@(guide) guide.slip, s.guides, "UniformOutput", false);
  T = rows_of(slip, middle); S = rows_of(slip, ahead); right = zeros(m, 1);
  for k = 1:m
    [~, rate] = law_at(s.rows{k}.law, t + h);
    right(k) = rate - (coordinate(s.rows{k}, s.q) - law_at(s.rows{k}.law, t)) / (10 * h);
  end
  A = [diag(s.mass), -rows_of(s.rows, middle)'; rows_of(s.rows, ahead), zeros(m)];
  if rcond(A) < eps, fprintf(stderr, "constraints that depend on each other: a singular matrix\n"); exit(77); end
  found = A \ [[s.mass .* s.v + h * forces(s, t + h / 2, middle, s.v); right], [T'; zeros(m, rows(T))]];
  x = found(:, 1); unit = found(:, 2:end); P = zeros(rows(T), 1);
  for turn = 1:200  % a friction changes the loads, also of other guides
    before = P;
    for k = 1:numel(P)
      guide = s.guides{k}; own = n + guide.normal + (0:1); gain = S(k, :) * unit(1:n, k);
      held = P(k) - S(k, :) * x(1:n) / gain;  % the impulse that ends the slip
      side = 1 - 2 * (held < 0); most = bound(guide, guide.mu, side, x(own)); P(k) = max(-most, min(most, held));
      was = T(k, :) * s.v; will = gain * (P(k) - held);
      if (abs(was) < 1e-9 || was * will <= 0) ...  % at rest, or on its way through rest
          && abs(held) <= bound(guide, guide.mus, side, x(own) + (held - before(k)) * unit(own, k)), P(k) = held; end
      x += (P(k) - before(k)) * unit(:, k);
    end
    if all(abs(P - before) <= 1e-12 * abs(P)), break, end
  end
  w = x(1:n);
end

function simulate(scene_file, result_file, dt, output_step)
  scene = jsondecode(fileread(scene_file), "makeValidName", false).scene;
  s = read_scene(scene); steps = max(1, round(scene.t_end / str2double(dt))); h = scene.t_end / steps;
  every = max(1, floor(str2double(output_step) / h + 1e-9)); out = fopen(result_file, "w"); head = {"t"}; last = [];
  for labels = {{"x", "y", "angle"}, {"vx", "vy", "omega"}, {"ax", "ay", "alpha"}}
    for name = s.names, head = [head, strcat(name{1}, ".", labels{1})]; end
  end
  fprintf(out, "%s\n", strjoin([head, strcat(s.frictions, ".friction")], ","));
  for k = 0:steps
    [w, P] = step(s, k * h, h);
    now = [(w - s.v); P] / h;
    if isempty(last), last = now; end
    if mod(k, every) == 0 || k == steps  % accelerations and frictions at an instant are the mean of both sides'
      row = [k * h; s.q; s.v; (now + last) / 2];
      fprintf(out, "%s\n", strjoin(arrayfun(@(x) sprintf("%.17g", x), row', "UniformOutput", false), ","));
    end
    s.q += h / 2 * (s.v + w); s.v = w; last = now;
  end
  fclose(out);
end

given = argv();
if strcmp(given{end}, "--version"), disp("octave-example 1.0"), else, simulate(given{end-3:end}), end
