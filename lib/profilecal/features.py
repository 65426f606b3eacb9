def find_features(kind, profiles, radius=None):
    raise NotImplementedError
