-- Poses (x, y, z, qx, qy, qz, qw) as arithmetic.

CREATE FUNCTION pose_rotate(pose double precision[], x double precision, y double precision, z double precision)
RETURNS double precision[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The vector (x, y, z), turned by the pose's quaternion q: v + 2w(q x v) + 2q x (q x v).
DECLARE
    qx double precision := pose[4]; qy double precision := pose[5];
    qz double precision := pose[6]; qw double precision := pose[7];
    tx double precision := 2 * (qy * z - qz * y);
    ty double precision := 2 * (qz * x - qx * z);
    tz double precision := 2 * (qx * y - qy * x);
BEGIN
    RETURN ARRAY[x + qw * tx + qy * tz - qz * ty,
                 y + qw * ty + qz * tx - qx * tz,
                 z + qw * tz + qx * ty - qy * tx];
END $$;

CREATE FUNCTION pose_compose(a double precision[], b double precision[])
RETURNS double precision[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The pose b, given in the frame a, in a's outer frame.
DECLARE
    t double precision[];
    x double precision; y double precision; z double precision; w double precision;
    n double precision;
BEGIN
    IF a[4] = 0 AND a[5] = 0 AND a[6] = 0 THEN
        RETURN ARRAY[a[1] + b[1], a[2] + b[2], a[3] + b[3], b[4], b[5], b[6], b[7]];
    END IF;
    t := semmap.pose_rotate(a, b[1], b[2], b[3]);
    x := a[7]*b[4] + a[4]*b[7] + a[5]*b[6] - a[6]*b[5];
    y := a[7]*b[5] - a[4]*b[6] + a[5]*b[7] + a[6]*b[4];
    z := a[7]*b[6] + a[4]*b[5] - a[5]*b[4] + a[6]*b[7];
    w := a[7]*b[7] - a[4]*b[4] - a[5]*b[5] - a[6]*b[6];
    n := sqrt(x*x + y*y + z*z + w*w);
    RETURN ARRAY[a[1] + t[1], a[2] + t[2], a[3] + t[3], x/n, y/n, z/n, w/n];
END $$;

CREATE FUNCTION pose_inverse(a double precision[])
RETURNS double precision[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The outer frame, in the frame a.
DECLARE
    conjugate double precision[] := ARRAY[0, 0, 0, -a[4], -a[5], -a[6], a[7]];
    t double precision[] := semmap.pose_rotate(conjugate, -a[1], -a[2], -a[3]);
BEGIN
    RETURN t || conjugate[4:7];
END $$;

CREATE FUNCTION pose_apply(geom geometry, pose double precision[])
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- A geometry of the frame `pose`, in the outer frame.
SELECT ST_Affine(geom,
    1 - 2 * (pose[5]*pose[5] + pose[6]*pose[6]), 2 * (pose[4]*pose[5] - pose[6]*pose[7]), 2 * (pose[4]*pose[6] + pose[5]*pose[7]),
    2 * (pose[4]*pose[5] + pose[6]*pose[7]), 1 - 2 * (pose[4]*pose[4] + pose[6]*pose[6]), 2 * (pose[5]*pose[6] - pose[4]*pose[7]),
    2 * (pose[4]*pose[6] - pose[5]*pose[7]), 2 * (pose[5]*pose[6] + pose[4]*pose[7]), 1 - 2 * (pose[4]*pose[4] + pose[5]*pose[5]),
    pose[1], pose[2], pose[3]);
END;

CREATE FUNCTION pose_yaw(pose double precision[])
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- Heading of the frame's x axis in the outer xy plane, radians.
SELECT atan2(2 * (pose[4]*pose[5] + pose[6]*pose[7]), 1 - 2 * (pose[5]*pose[5] + pose[6]*pose[6]));
END;

CREATE FUNCTION planar_pose(x double precision, y double precision, yaw double precision DEFAULT 0, z double precision DEFAULT 0)
RETURNS double precision[] LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
SELECT ARRAY[x, y, z, 0, 0, sin(yaw / 2), cos(yaw / 2)];
END;

CREATE FUNCTION turn_to_x(line geometry)
RETURNS double precision[] LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE STRICT SET search_path = semmap, public, pg_temp AS $$
-- The pose that turns the direction of a line of two points to (1, 0, 0); no turn where they are one.
DECLARE
    x double precision := ST_X(ST_EndPoint(line)) - ST_X(ST_StartPoint(line));
    y double precision := ST_Y(ST_EndPoint(line)) - ST_Y(ST_StartPoint(line));
    z double precision := ST_Z(ST_EndPoint(line)) - ST_Z(ST_StartPoint(line));
    far double precision := sqrt(x*x + y*y + z*z);
    w double precision := far + x;
    n double precision := sqrt(w*w + y*y + z*z);
BEGIN
    IF far = 0 THEN
        RETURN ARRAY[0, 0, 0, 0, 0, 0, 1];
    ELSIF n = 0 THEN  -- it is (-1, 0, 0)
        RETURN ARRAY[0, 0, 0, 0, 0, 1, 0];
    END IF;
    RETURN ARRAY[0, 0, 0, 0, z/n, -y/n, w/n];
END $$;

CREATE FUNCTION diagonal(geom geometry)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
BEGIN ATOMIC
-- The 3D box of a geometry, as the line from its lowest corner to its highest.
SELECT ST_MakeLine(ST_MakePoint(ST_XMin(geom), ST_YMin(geom), ST_ZMin(geom)),
                   ST_MakePoint(ST_XMax(geom), ST_YMax(geom), ST_ZMax(geom)));
END;

CREATE FUNCTION box_distance(box geometry, x double precision, y double precision, z double precision)
RETURNS double precision LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- Metres from a point to a 3D box (given as its diagonal); 0 inside.
SELECT sqrt(power(greatest(ST_XMin(box) - x, x - ST_XMax(box), 0), 2)
          + power(greatest(ST_YMin(box) - y, y - ST_YMax(box), 0), 2)
          + power(greatest(ST_ZMin(box) - z, z - ST_ZMax(box), 0), 2));
END;

CREATE FUNCTION around(x double precision, y double precision, z double precision, distance double precision)
RETURNS geometry LANGUAGE sql IMMUTABLE PARALLEL SAFE
BEGIN ATOMIC
-- The diagonal of the cube that reaches `distance` metres from a point to each side: the index is queried with it.
SELECT ST_MakeLine(ST_MakePoint(x - distance, y - distance, z - distance),
                   ST_MakePoint(x + distance, y + distance, z + distance));
END;
