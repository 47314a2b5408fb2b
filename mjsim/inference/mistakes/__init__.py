"""What people really get wrong in a campaign (unit, sign, direction, feed, swapped traces), recognised from the
data.
"""
